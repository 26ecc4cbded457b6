% What a call costs besides the work it reports: CPU seconds here and in the child.
clear all
[objPoly, ineqPolySys, lbd, ubd] = quartics(1, -1);
param.printLevel = 0;
param.relaxOrder = 2;
sparsePOP(objPoly, ineqPolySys, lbd, ubd, param);
child = serving();
assert(numel(child), 1)
stat = sprintf('/proc/%d/stat', child);
ticks = @() sum(str2double(strsplit(regexprep(fileread(stat), '^.*\) ', ''), ' ')(12:13)));
calls = 10;
reported = 0;
before = cputime();
started = tic();
spent = ticks();
for k = 1:calls
    [~, ~, ~, cpuTime] = sparsePOP(objPoly, ineqPolySys, lbd, ubd, param);
    reported = reported + cpuTime.total + cpuTime.readData + cpuTime.localMethod;
end
waited = toc(started) / calls;
here = (cputime() - before) / calls;
there = ((ticks() - spent) / 100 - reported) / calls;
printf(['overhead of a call: %.3f s of CPU here, %.3f s in Python; %.3f s reported, ' ...
        '%.3f s of wall time\n'], here, there, reported / calls, waited)
assert(here + there < 0.3)
