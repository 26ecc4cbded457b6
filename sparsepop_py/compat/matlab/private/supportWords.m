function words = supportWords(supports)
% Monomials as rows of letters: x1^2 x3 is [1 1 3], shorter ones end with n + 1.
%
%   Rows in ascending order are supports in descending lexicographic order, and are short where
%   supports have thousands of columns.

[n, count] = deal(size(supports, 2), size(supports, 1));
[letter, row, power] = find(supports.');  % row after row, letters ascending
% each entry as often as its power says: repelem fails for one entry, and for none
item = cumsum(accumarray([1; cumsum(full(power(:))) + 1], 1));
item = reshape(item(1:end-1), [], 1);
[letter, row] = deal(letter(:), row(:));
[letter, row] = deal(reshape(letter(item), [], 1), reshape(row(item), [], 1));
degree = accumarray([row; count], [ones(numel(row), 1); 0], [count, 1]);
before = cumsum([0; degree(1:end-1)]);
place = (1:numel(row)).' - before(row);
words = repmat(n + 1, count, max([degree; 1]));
words(sub2ind(size(words), row, place)) = letter;
end
