% What scripts and other toolboxes do with calls and outputs: structs without sizeCone, one struct
% used for both signs, columns cut and indexed, outputs left out, the whole call inside evalc.
clear all
n = 4;                              % p1, p2 and two errors within 0.1
row = struct('typeCone', -1, 'degree', 1, 'dimVar', n, 'noTerms', 3);
row.supports = [0 0 0 0; 1 0 0 0; 0 0 1 0];  row.coef = [-2 1 1];       % p1 + e1 = 2, a row
ineqPolySys{1} = row;
row.supports = [0 0 0 0; 0 1 0 0; 0 0 0 1];  row.coef = [-3; 1; -1];    % p2 - e2 = 3
ineqPolySys{2} = row;
lbd = [-1e10*ones(2,1); -.1*ones(2,1)];
ubd = -lbd;
param.relaxOrder = 1;
param.POPsolver = 'interior-point';
param.printLevel = 0;
for i = 1:2
    supp = zeros(1, n);
    supp(i) = 1;
    objPoly = struct('noTerms', 1, 'dimVar', n, 'degree', 1, 'typeCone', 1, 'supports', supp);
    objPoly.coef = 1;
    [a, b, POP] = sparsePOP(objPoly, ineqPolySys, lbd, ubd, param);
    relaxed(i, 1) = POP.xVect(i);
    refined(i, 1) = POP.xVectL(i);
    without_last = POP.xVectL(1:end-1);
    assert(size(without_last), [n-1, 1])
    theta(i, 1) = POP.objValueL;
    objPoly.coef = -1;
    objPoly.typeConde = 1;          % misspelled fields of polynomials are ignored, as they were
    [~, ~, POP] = sparsePOP(objPoly, ineqPolySys, lbd, ubd, param);
    relaxed(i, 2) = POP.xVect(i);
    refined(i, 2) = POP.xVectL(i);
    theta(i, 2) = -POP.objValueL;
end
assert(refined, [1.9 2.1; 2.9 3.1], 1e-6)
assert(relaxed, [1.9 2.1; 2.9 3.1], 1e-6)
assert(theta, [1.9 2.1; 2.9 3.1], 1e-6)

% as YALMIP calls it: rows, everything inside evalc, xVect taken when it is not empty
obj = struct('typeCone', 1, 'sizeCone', 1, 'degree', 2, 'noTerms', 2, 'dimVar', 2);
obj.coef = [1; 1];
obj.supports = [2 0; 0 2];
constraint{1} = struct('typeCone', 1, 'degree', 1, 'noTerms', 3, 'dimVar', 2);
constraint{1}.coef = [-1; 1; 1];
constraint{1}.supports = [0 0; 1 0; 0 1];
lb = [-1e10 -1e10];
ub = [1e10 1e10];
paramin = struct('relaxOrder', 1);
evalc('[param,SDPobjValue,POP,cpuTime,SDPsolverInfo,SDPinfo] = sparsePOP(obj,constraint,lb,ub,paramin);');
assert(~isempty(POP.xVect))
assert(POP.xVect, [1/2; 1/2], 1e-3)
assert(SDPobjValue, 1/2, 1e-6)

% filled also where no point exists or is known, with the violation beside it
constraint{2} = struct('typeCone', 1, 'degree', 2, 'noTerms', 2, 'dimVar', 2);
constraint{2}.coef = [-1; -1];
constraint{2}.supports = [0 0; 2 0];                    % - 1 - x1^2 >= 0
paramin.printLevel = 0;
[~,SDPobjValue,POP] = sparsePOP(obj, constraint, lb, ub, paramin);
assert(SDPobjValue, Inf)
assert(numel(POP.xVect), 2)
assert(POP.violation >= 1)
