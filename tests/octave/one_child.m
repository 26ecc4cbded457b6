% One child process serves all calls, through "clear all" and changes of folder; a child that
% was lost is replaced.
clear all
children = @() strsplit(strtrim(nthargout(2, @system, ...
    sprintf('ps --ppid %d -o pid= -o args= | grep [d]oor.serve || true', getpid()))), "\n");
param.printLevel = 0;
param.relaxOrder = 2;
sparsePOP('quartics(1, -1)', param);
before = children();
assert(numel(before), 1)

here = pwd;
cd(tempdir)
clear -x here before children param
sparsePOP('quartics(1, -1)', param);
cd(here)
save('-v6', fullfile(tempdir, 'kept.mat'), 'before')
clear all
sparsePOP('quartics(1, -1)', struct('printLevel', 0));
children = @() strsplit(strtrim(nthargout(2, @system, ...
    sprintf('ps --ppid %d -o pid= -o args= | grep [d]oor.serve || true', getpid()))), "\n");
load(fullfile(tempdir, 'kept.mat'))
delete(fullfile(tempdir, 'kept.mat'))
assert(children(), before)

% its pipes closed by "fclose all", or killed: the next call has a new one
fclose all;
[~, SDPobjValue] = sparsePOP('quartics(1, -1)', struct('printLevel', 0, 'relaxOrder', 2));
assert(SDPobjValue, -1, 1e-5)
after = children();
assert(~any(strcmp(after, before{1})))
kill(sscanf(after{1}, '%d'), 9);
pause(0.2)
[~, SDPobjValue] = sparsePOP('quartics(1, -1)', struct('printLevel', 0, 'relaxOrder', 2));
assert(SDPobjValue, -1, 1e-5)
assert(~any(strcmp(children(), after{1})))
