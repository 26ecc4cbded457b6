function [sorted, order] = monomialSort(supports, used, kind)
%MONOMIALSORT  Sort monomials, the rows of supports, upwards.
%
%   [sorted, order] = monomialSort(supports, used, kind) compares the columns used. kind is 'lex'
%   (the default), 'grlex' (by degree, then lexicographic) or 'grevlex' (by degree, then larger
%   powers of earlier variables first). sorted is supports(order, :).

if nargin < 3
    kind = 'lex';
end
words = supportWords(supports(:, used));
degree = full(sum(supports(:, used), 2));
switch kind
    case 'lex'
        keys = -words;
    case 'grlex'
        keys = [degree, -words];
    case 'grevlex'
        keys = [degree, words];
    otherwise
        error('sparsePOP:input', 'monomialSort: found ''%s'', expected lex, grlex or grevlex', kind);
end
[~, order] = sortrows(keys);
sorted = supports(order, :);
end
