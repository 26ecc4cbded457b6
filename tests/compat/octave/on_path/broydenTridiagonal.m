function [objPoly, ineqPolySys, lbd, ubd] = broydenTridiagonal(n)
% sum of squares of (3 - 2 x_i) x_i - x_{i-1} - 2 x_{i+1} + 1, with x_0 = x_{n+1} = 0
objPoly = struct('typeCone', 1, 'sizeCone', 1, 'dimVar', n, 'degree', 4, 'noTerms', 0, ...
                 'supports', sparse(0, n), 'coef', []);
for i = 1:n
    r = objPoly;
    r.supports = sparse(5, n);
    r.supports(1, i) = 1;
    r.supports(2, i) = 2;
    r.coef = [3; -2; 0; 0; 1];
    if i > 1
        r.supports(3, i-1) = 1;
        r.coef(3) = -1;
    end
    if i < n
        r.supports(4, i+1) = 1;
        r.coef(4) = -2;
    end
    squared = multiplyPolynomials(simplifyPolynomial(r), r);
    objPoly.supports = [objPoly.supports; squared.supports];
    objPoly.coef = [objPoly.coef; squared.coef];
end
objPoly = simplifyPolynomial(objPoly);
ineqPolySys = [];
lbd = -1e10 * ones(1, n);
ubd = 1e10 * ones(1, n);
end
