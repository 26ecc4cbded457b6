% A line y = p1 u + p2 + e through three readings with |e| <= 1/2, at u = -1, 0, 1.
% y = -1, 0, 1: |p1 - 1| + |p2| <= 1/2, so that p1 is in [1/2, 3/2] and p2 in [-1/2, 1/2].
% y = -1, 0, 4: the outer readings ask for p2 in [1, 2], the middle one for [-1/2, 1/2]: none.
clear; close all; clc

u = [-1; 0; 1];
records = {[-1; 0; 1], [-1; 0; 4]};
ends = {1:4, 1:2};                  % p1 min, p1 max, p2 min, p2 max
N = numel(u); n = 2 + N;
param.relaxOrder = 1;
param.sparseSW = 1;
param.SDPsolver = 'sedumi';
param.POPsolver = 'interior-point';
param.printLevel = [0, 0];

for r = 1:numel(records)
    y = records{r};
    ineqPolySys = cell(N,1);
    for k = 1:N
        poly = struct();
        poly.typeCone = -1;
        poly.sizeCone = 1;
        poly.dimVar = n;
        poly.degree = 1;
        poly.supports = [sparse(1,n); speye(2,n); sparse(1,2+k,1,1,n)];
        poly.coef = [-y(k); u(k); 1; 1];
        poly.supports = poly.supports(poly.coef ~= 0,:);
        poly.coef = poly.coef(poly.coef ~= 0);
        poly.noTerms = size(poly.supports,1);
        ineqPolySys{k} = poly;
    end
    assert(all(cellfun(@(p) p.noTerms == numel(p.coef), ineqPolySys)))
    lbd = [-1e10; -1e10; -0.5*ones(N,1)];
    ubd = -lbd;
    clear SDPobjValue reached
    for i = ends{r}
        objPoly.typeCone = 1;
        objPoly.sizeCone = 1;
        objPoly.dimVar = n;
        objPoly.degree = 1;
        objPoly.noTerms = 1;
        objPoly.supports = sparse(1,ceil(i/2),1,1,n);
        objPoly.coef = 1 - 2*(mod(i,2) == 0);
        [param,SDPobjValue(i),POP,cpuTime,SDPsolverInfo,SDPinfo] = ...
            sparsePOP(objPoly,ineqPolySys,lbd,ubd,param);
        if isempty(POP.xVectL)
            reached(i) = NaN;
        else
            reached(i) = POP.xVectL(ceil(i/2));
        end
    end
    fprintf('record %d:%s\n', r, sprintf(' %g', reached));
    if r == 1
        assert(reached, [1/2 3/2 -1/2 1/2], 1e-5)
        assert(SDPobjValue, [1/2 -3/2 -1/2 -1/2], 1e-5)
        assert(all(SDPobjValue <= [1/2 -3/2 -1/2 -1/2]))
    else
        assert(all(isnan(reached)))
        assert(all(SDPobjValue == Inf))
        assert(POP.status, 'INFEASIBLE')
    end
end
