% Coefficients in multiples of 1/8 of a symmetric filter of length 5 that is closest to a low
% pass, each an integer written with binaries; the script stops on numerical trouble, as published
% ones do. Enumeration of all 512 choices says what is best.
clear all
w = [0 pi/3 2*pi/3 pi];
desired = [1 1 0 0];
grid_ = -4:3;                                     % values of 8 h, three bits each
basis = [ones(4, 1), 2*cos(w.'), 2*cos(2*w.')];   % response of h0, h1, h2
n = 9;
bits = zeros(3, n);
for k = 1:3
    bits(k, 3*k-2:3*k) = [-4 2 1] / 8;
end
linear = basis * bits;                            % response as a function of the binaries

objPoly.typeCone = 1; objPoly.sizeCone = 1; objPoly.dimVar = n; objPoly.degree = 2;
objPoly.supports = sparse(0, n); objPoly.coef = [];
for s = 1:4
    r = struct('typeCone', 1, 'sizeCone', 1, 'dimVar', n, 'degree', 1, 'noTerms', n+1, ...
               'supports', [speye(n); sparse(1, n)], 'coef', [linear(s, :).'; -desired(s)]);
    squared = multiplyPolynomials(r, r);
    objPoly.supports = [objPoly.supports; squared.supports];
    objPoly.coef = [objPoly.coef; squared.coef];
end
objPoly = simplifyPolynomial(objPoly);
for k = 1:n                                       % b^2 - b = 0
    e = sparse(1, k, 1, 1, n);
    ineqPolySys{k} = struct('typeCone', -1, 'sizeCone', 1, 'dimVar', n, 'degree', 2, ...
                            'noTerms', 2, 'supports', [2*e; e], 'coef', [1; -1]);
end
param.relaxOrder = 2;
param.SDPsolverEpsilon = 1e-6;
param.printLevel = 0;
[param,SDPobjValue,POP,cpuTime,SDPsolverInfo,SDPinfo] = ...
    sparsePOP(objPoly, ineqPolySys, zeros(1, n), ones(1, n), param);
if SDPsolverInfo.numerr ~= 0 || SDPsolverInfo.pinf ~= 0 || SDPsolverInfo.dinf ~= 0
    error('the solver has had numerical trouble');
end

best = Inf;
for a = grid_, for b = grid_, for c = grid_
    best = min(best, sum((basis * [a; b; c] / 8 - desired.').^2));
end, end, end
assert(POP.objValue, best, 1e-6)
assert(SDPobjValue, best, 1e-5)
x = round(POP.xVect);
assert(POP.xVect, x, 1e-6)
assert(sum((linear * x - desired.').^2), best, 1e-9)
