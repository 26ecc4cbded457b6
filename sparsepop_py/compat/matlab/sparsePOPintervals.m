function [lo, hi, detail] = sparsePOPintervals(ineqPolySys, lbd, ubd, indices, param)
%SPARSEPOPINTERVALS  Proved intervals of chosen variables over one feasible set.
%
%   [lo, hi] = sparsePOPintervals(ineqPolySys, lbd, ubd, indices, param)
%
%   lo(i) <= x(indices(i)) <= hi(i) holds for every x with these constraints and bounds; -Inf and
%   Inf where nothing is proved, lo = Inf and hi = -Inf where no point is feasible. lo and hi are
%   columns. indices may be left out or [] (all variables), and so may param. One call does the
%   work of the 2p calls of sparsePOP that minimise and maximise each variable; they share boxes
%   and relaxations. Without param.effort and param.tighten the effort is 'auto', which closes what
%   one relaxation leaves open, within param.timeLimit seconds for all (60 by default).
%
%   [lo, hi, detail] = ... returns a struct with the columns innerLo and innerHi, values that
%   provably feasible points attain, and the cell array status: what is known of each end.

if nargin < 3 || nargin > 5
    error('sparsePOP:input', ['Input has something wrong: expected ' ...
          'sparsePOPintervals(ineqPolySys, lbd, ubd, indices, param).']);
end
if nargin < 4
    indices = [];
end
if nargin < 5
    param = struct();
end
answer = handOver('sparsePOPintervals', {ineqPolySys, lbd, ubd, indices, param});
detail = answer.outputs{1};
lo = detail.lo;
hi = detail.hi;
end
