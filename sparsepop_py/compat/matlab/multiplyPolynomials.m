function poly = multiplyPolynomials(first, second)
%MULTIPLYPOLYNOMIALS  Product of two polynomials in SparsePOP's format, simplified.
%
%   The coefficients of both have one column. typeCone and sizeCone are those of the first.

poly = first;
[i, j] = ndgrid(1:size(first.supports, 1), 1:size(second.supports, 1));
poly.supports = sparse(first.supports(i, :)) + sparse(second.supports(j, :));
poly.coef = first.coef(i(:), 1) .* second.coef(j(:), 1);
poly = simplifyPolynomial(poly);
end
