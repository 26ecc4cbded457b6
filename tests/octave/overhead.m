% What a call costs besides the work it reports: CPU seconds here and in the child.
clear all
[objPoly, ineqPolySys, lbd, ubd] = quartics(1, -1);
param.printLevel = 0;
param.relaxOrder = 2;
sparsePOP(objPoly, ineqPolySys, lbd, ubd, param);
[~, child] = system(sprintf('ps --ppid %d -o pid= -o args= | grep [d]oor.serve', getpid()));
stat = sprintf('/proc/%d/stat', sscanf(child, '%d', 1));
ticks = @() sum(str2double(strsplit(regexprep(fileread(stat), '^.*\) ', ''), ' ')(12:13)));
calls = 10;
reported = 0;
before = cputime();
spent = ticks();
for k = 1:calls
    [~, ~, ~, cpuTime] = sparsePOP(objPoly, ineqPolySys, lbd, ubd, param);
    reported = reported + cpuTime.total + cpuTime.readData + cpuTime.localMethod;
end
here = (cputime() - before) / calls;
there = ((ticks() - spent) / 100 - reported) / calls;
printf('overhead of a call: %.3f s of CPU here, %.3f s in Python, %.3f s reported\n', ...
       here, there, reported / calls)
assert(here + there < 0.3)
