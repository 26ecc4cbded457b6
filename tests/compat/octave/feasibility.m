% Questions of feasibility: a constant objective, with and without a point.
clear all
objPoly = struct('typeCone', 1, 'sizeCone', 1, 'dimVar', 2, 'degree', 0, 'noTerms', 1, ...
                 'supports', [0 0], 'coef', 0);
disc = struct('typeCone', 1, 'sizeCone', 1, 'dimVar', 2, 'degree', 2, 'noTerms', 3, ...
              'supports', [0 0; 2 0; 0 2], 'coef', [1; -1; -1]);
line = struct('typeCone', -1, 'sizeCone', 1, 'dimVar', 2, 'degree', 1, 'noTerms', 3, ...
              'supports', [0 0; 1 0; 0 1], 'coef', [-1; 1; 1]);
param.relaxOrder = 1;
param.printLevel = 0;

% x1 + x2 = 1 meets the disc: 0 at a point that satisfies both
[~,SDPobjValue,POP,cpuTime,SDPsolverInfo,SDPinfo] = ...
    sparsePOP(objPoly, {disc, line}, [-2 -2], [2 2], param);
assert(SDPobjValue, 0, 1e-6)
assert(POP.objValue, 0)
assert(sum(POP.xVect), 1, 1e-6)
assert(POP.xVect.' * POP.xVect <= 1 + 1e-6)
assert(POP.violation <= 1e-6)

% x1 + x2 = 2 does not, the distance of the line being sqrt(2)
line.coef(1) = -2;
[~,SDPobjValue,POP,cpuTime,SDPsolverInfo,SDPinfo] = ...
    sparsePOP(objPoly, {disc, line}, [-2 -2], [2 2], param);
assert(SDPobjValue, Inf)
assert(POP.status, 'INFEASIBLE')
assert(numel(POP.xVect), 2)
assert(POP.violation > 0)
assert(POP.absError, -POP.violation)
assert(any(SDPinfo.infeasibleSW == [0.5 1]))
assert(isscalar(POP.objValue) && isscalar(POP.scaledError))
assert(isempty(POP.xVectL))
for name = {'conversion', 'SDPsolver', 'total'}
    assert(cpuTime.(name{1}) >= 0)
end
assert([SDPsolverInfo.numerr SDPsolverInfo.pinf] == 0)
assert(isnumeric(SDPinfo.y))
