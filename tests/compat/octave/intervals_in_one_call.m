% The intervals of parameter_intervals.m by one call in place of 2p, under effort 'auto'.
clear all
p = 2;  n = 5;                      % variables p1 p2 d1 e1 e2
row = @(cone, supports, coef) struct('typeCone', cone, 'sizeCone', 1, 'dimVar', n, ...
    'degree', full(max(sum(supports, 2))), 'noTerms', size(supports, 1), ...
    'supports', supports, 'coef', coef);
ineqPolySys{1} = row(-1, [0 0 0 0 0; 0 0 0 1 0; 1 0 0 0 0; 1 0 1 0 0], [3; -1; -2; 1]);
ineqPolySys{2} = row(-1, [0 0 0 0 0; 0 0 0 0 1; 1 0 0 0 0; 0 1 0 0 0], [5; -1; -1; -1]);
lbd = [-10 -10 -.1 -.1 -.1];
ubd = [ 10  10  .1  .1  .1];
param.printLevel = 0;
param.relaxOrder = 2;
param.effort = 'auto';
param.timeLimit = 20;
param.gap = 1e-5;
least    = [2.9/2.1; 4.9 - 3.1/1.9];
greatest = [3.1/1.9; 5.1 - 2.9/2.1];
[lo, hi] = sparsePOPintervals(ineqPolySys, lbd, ubd, 1:p, param);
assert(size(lo), [2 1])
assert(lo, least, 1e-4)
assert(hi, greatest, 1e-4)
assert(all(lo <= least) && all(hi >= greatest))

% one of them, as they come; what is attained; all variables
[lo, hi, detail] = sparsePOPintervals(ineqPolySys, lbd, ubd, 2, param);
assert([lo hi], [least(2) greatest(2)], 1e-4)
assert(lo <= detail.innerLo && detail.innerHi <= hi)
assert([detail.innerLo detail.innerHi], [least(2) greatest(2)], 1e-4)
assert(detail.status, {'OPTIMAL', 'OPTIMAL'})
[lo, hi] = sparsePOPintervals(ineqPolySys, lbd, ubd);
assert(size(lo), [n 1])
assert(all(lo <= hi))

% no noise of these sizes explains the record
ubd(1) = 1;
[lo, hi] = sparsePOPintervals(ineqPolySys, lbd, ubd, [1 2]);
assert(lo, [Inf; Inf])
assert(hi, [-Inf; -Inf])

% a wrong index is an error that names it
try
    sparsePOPintervals(ineqPolySys, lbd, ubd, 6);
    error('no error');
catch problem
    assert(problem.message, 'indices: found 6.0, expected variables from 1 to 5, or ''a'' for all')
end
