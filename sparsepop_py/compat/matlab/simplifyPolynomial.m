function poly = simplifyPolynomial(poly, ~)
%SIMPLIFYPOLYNOMIAL  Add up terms with the same monomial, and drop those with coefficient zero.
%
%   poly = simplifyPolynomial(poly) takes and returns a struct of SparsePOP's format. Terms are
%   sorted as monomialSort does with 'grevlex'; degree and noTerms are set. Coefficients that are
%   not exactly zero stay, however small.

supports = sparse(poly.supports);
keys = [full(sum(supports, 2)), supportWords(supports)];
[~, first, term] = unique(keys, 'rows');
columns = size(poly.coef, 2);
[row, column, value] = find(poly.coef);
coef = accumarray([reshape(term(row), [], 1), column(:)], value(:), [numel(first), columns]);
kept = find(any(coef ~= 0, 2));
if isempty(kept)  % a polynomial has at least one term
    supports = sparse(1, size(supports, 2));
    coef = zeros(1, columns);
else
    supports = supports(first(kept), :);
    coef = coef(kept, :);
end
poly.supports = supports;
poly.coef = coef;
poly.noTerms = size(coef, 1);
poly.degree = full(max(sum(supports, 2)));
end
