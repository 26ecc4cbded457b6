% One child process serves all calls, through "clear all" and changes of folder; a child that
% was lost is replaced. SERVING keeps its number where "clear all" cannot reach.
clear all
serving = @() nthargout(2, @system, ...
    sprintf('ps --ppid %d -o pid= -o args= | grep [d]oor.serve', getpid()));
param.printLevel = 0;
param.relaxOrder = 2;
sparsePOP('quartics(1, -1)', param);
setenv('SERVING', serving())
assert(numel(strsplit(strtrim(serving()), "\n")), 1)

here = pwd;
cd(tempdir)
sparsePOP('quartics(1, -1)', param);
cd(here)
clear all
sparsePOP('quartics(1, -1)', struct('printLevel', 0));
serving = @() nthargout(2, @system, ...
    sprintf('ps --ppid %d -o pid= -o args= | grep [d]oor.serve', getpid()));
assert(serving(), getenv('SERVING'))

% its pipes closed by "fclose all", and their numbers given to other files: a new one
fclose all;
file = tempname();
other = arrayfun(@(k) fopen(file, 'w'), 1:4);
[~, SDPobjValue] = sparsePOP('quartics(1, -1)', struct('printLevel', 0, 'relaxOrder', 2));
assert(SDPobjValue, -1, 1e-5)
assert(all(arrayfun(@is_valid_file_id, other)))
arrayfun(@fclose, other);
delete(file)
after = serving();
assert(~isempty(after) && ~strcmp(after, getenv('SERVING')))

% killed: a new one
kill(sscanf(after, '%d', 1), 9);
while ~isempty(serving()), end
[~, SDPobjValue] = sparsePOP('quartics(1, -1)', struct('printLevel', 0, 'relaxOrder', 2));
assert(SDPobjValue, -1, 1e-5)
assert(~isempty(serving()) && ~strcmp(serving(), after))
