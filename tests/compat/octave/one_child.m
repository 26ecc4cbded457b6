% One child process serves all calls, through "clear all" and changes of folder; a child that
% was lost is replaced. SERVING keeps its number where "clear all" cannot reach.
clear all
param.printLevel = 0;
param.relaxOrder = 2;
sparsePOP('quartics(1, -1)', param);
assert(numel(serving()), 1)
setenv('SERVING', num2str(serving()))

here = pwd;
cd(tempdir)
sparsePOP('quartics(1, -1)', param);
cd(here)
clear all
sparsePOP('quartics(1, -1)', struct('printLevel', 0));
first = serving();
assert(first, str2double(getenv('SERVING')))

% its pipes closed by "fclose all", and their numbers given to other files: a new one
fclose all;
file = tempname();
other = arrayfun(@(k) fopen(file, 'w'), 1:4);
[~, SDPobjValue] = sparsePOP('quartics(1, -1)', struct('printLevel', 0, 'relaxOrder', 2));
assert(SDPobjValue, -1, 1e-5)
assert(all(arrayfun(@is_valid_file_id, other)))
arrayfun(@fclose, other);
delete(file)
second = setdiff(serving(), first);  % the first may take a moment to end
assert(numel(second), 1)

% killed: a new one
kill(second, 9);
while any(serving() == second), pause(0.01); end
[~, SDPobjValue] = sparsePOP('quartics(1, -1)', struct('printLevel', 0, 'relaxOrder', 2));
assert(SDPobjValue, -1, 1e-5)
assert(numel(setdiff(serving(), [first; second])), 1)
