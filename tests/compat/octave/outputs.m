% The names, shapes, classes and empties of what is returned. min x1^2 + x2 on the line
% x1 + x2 = 1 in the unit square is 3/4 at (1/2, 1/2).
clear all
objPoly = struct('typeCone',1,'sizeCone',1,'dimVar',2,'degree',2,'noTerms',2, ...
                 'supports',[2 0; 0 1],'coef',[1; 1]);
line = struct('typeCone',-1,'sizeCone',1,'dimVar',2,'degree',1,'noTerms',3, ...
              'supports',[1 0; 0 1; 0 0],'coef',[1; 1; -1]);
param.printLevel = [0 0];
[given,SDPobjValue,POP,cpuTime,SDPsolverInfo,SDPinfo] = ...
    sparsePOP(objPoly,{line},[0 0],[1 1],param);

assert(SDPobjValue, 3/4, 1e-6)
assert(size(POP.xVect), [2 1])
assert(POP.xVect, [1/2; 1/2], 1e-3)
assert(POP.objValue, 3/4, 1e-6)
assert(POP.absError <= 0 && POP.scaledError <= 0 && POP.absError > -1e-6)
assert(~issparse(POP.absError))
assert(isempty(POP.xVectL) && isempty(POP.objValueL))
assert(isempty(POP.absErrorL) && isempty(POP.scaledErrorL))
assert(isa(POP.xVectL, 'double'))
assert(ischar(POP.status))
assert(POP.status, 'OPTIMAL')
assert(POP.lowerBound <= 3/4 && 3/4 <= POP.upperBound)
assert(POP.solverValue, 3/4, 1e-5)
assert(POP.certificate.bound, SDPobjValue)
assert(all(cellfun(@ischar, POP.notes)))

has = @(s, names) all(cellfun(@(name) isfield(s, name), names));
assert(has(POP, {'xVect','objValue','objValueScaled','absError','scaledError', ...
                 'xVectL','objValueL','absErrorL','scaledErrorL'}))
assert(has(cpuTime, {'conversion','SDPsolver','total','readData','localMethod'}))
assert(has(SDPsolverInfo, {'iter','feasratio','pinf','dinf','numerr','r0','timing', ...
                           'wallsec','cpusec','err'}))
assert(has(SDPinfo, {'rowSizeA','colSizeA','nonzerosInA','noOfFreevar','noOfLPvariables', ...
                     'SOCPblock','SDPblock','reduceAMatSW','infeasibleSW','objConstant', ...
                     'objValScale','SeDuMiA','SeDuMib','SeDuMic','SeDuMiK','Amat','bVect', ...
                     'dimVar0','dimVar','fixedVar','x','y','xIdxVec'}))
assert(SDPsolverInfo.numerr + SDPsolverInfo.pinf + SDPsolverInfo.dinf, 0)
assert(isscalar(SDPsolverInfo.iter) && isscalar(cpuTime.total))
assert([SDPinfo.dimVar0 SDPinfo.dimVar SDPinfo.infeasibleSW], [2 2 0])
assert(isempty(SDPinfo.SOCPblock) && isempty(SDPinfo.fixedVar))
assert(size(SDPinfo.SDPblock,1), 1)
assert(isa(SDPinfo.rowSizeA, 'double'))

% the returned param has every field and serves again
assert(has(given, {'relaxOrder','sparseSW','multiCliquesFactor','scalingSW','boundSW', ...
                   'eqTolerance','perturbation','SDPsolver','SDPsolverEpsilon','printLevel'}))
assert([given.relaxOrder given.printLevel], [1 0 0])
again = sparsePOP(objPoly,{line},[0 0],[1 1],given);
assert(again, given)

% no feasible point: +Inf; xVect is the nearest vector that is known, and its violation is beside it
[given,SDPobjValue,POP,cpuTime,SDPsolverInfo,SDPinfo] = ...
    sparsePOP(objPoly,{line},[0 0],[0.1 0.1],param);
assert(SDPobjValue, Inf)
assert(POP.status, 'INFEASIBLE')
assert(size(POP.xVect), [2 1])
assert(POP.violation > 0 && isempty(POP.xVectL))
