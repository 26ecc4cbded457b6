% Every calling form; x1 + x2 >= 1 on a box, objective x1^2 + x2^2: 1/2 at (1/2, 1/2).
clear all
objPoly.typeCone = 1; objPoly.sizeCone = 1; objPoly.dimVar = 2; objPoly.degree = 2;
objPoly.noTerms = 2; objPoly.supports = sparse([2 0; 0 2]); objPoly.coef = [1; 1];
above.typeCone = 1; above.sizeCone = 1; above.dimVar = 2; above.degree = 1;
above.noTerms = 3; above.supports = sparse([1 0; 0 1; 0 0]); above.coef = sparse([1; 1; -1]);
param.relaxOrder = 1;
param.printLevel = 0;

value = @(varargin) nthargout(2, @sparsePOP, varargin{:}, param);
rows  = {{above}, {above, above}, {above; above}};
lower = {[-2 -2], [-2; -2], sparse([-2 -2]), sparse([-2; -2]), [-1e10 -1e10], [-Inf -Inf]};
upper = {[2 2], [2; 2], sparse([2 2]), sparse([2; 2]), [1e10 1e10], [Inf; Inf]};
for k = 1:numel(rows)
    assert(value(objPoly, rows{k}, lower{k}, upper{k}), 1/2, 1e-6)
end
for k = numel(rows)+1:numel(lower)
    assert(value(objPoly, rows{1}, lower{k}, upper{k}), 1/2, 1e-6)
end

% no constraints, in both ways of writing it; a zero bound kept by a sparse vector
for none = {[], {}}
    assert(value(objPoly, none{1}, sparse([1 0]), sparse([2 0])), 1, 1e-6)
end

% least squares: (x1 - 1)^2 + (x2 - x1^2)^2 is least, 0, at (1, 1)
first = objPoly;  first.degree = 1;  first.supports = [1 0; 0 0];  first.coef = [1; -1];
second = objPoly; second.supports = [0 1; 2 0]; second.coef = [1; -1];
param.POPsolver = 'lsqnonlin';
param.relaxOrder = 2;
for residuals = {{first, second}, {first; second}}
    [~,SDPobjValue,POP] = sparsePOP(residuals{1}, [], [-5 -5], [5 5], param);
    assert(SDPobjValue, 0, 1e-5)
    assert(POP.xVect, [1; 1], 1e-2)
end

% a call written as a string, and files on the path: minimum -3, maximum 3.25
param = struct('printLevel', 0, 'relaxOrder', 2);
assert(nthargout(2, @sparsePOP, 'quartics(3, -1)', param), -3, 1e-5)
[~,SDPobjValue,POP] = sparsePOP('largest.gms', param);
assert(SDPobjValue, 3.25, 1e-5)
assert(SDPobjValue >= 3.25)
assert(POP.objValue, 3.25, 1e-5)
[~,SDPobjValue] = sparsePOP(fullfile('on_path', 'largest.gms'), param);
assert(SDPobjValue, 3.25, 1e-5)

% one input prints its report
shown = evalc('[~,SDPobjValue] = sparsePOP(''largest.gms'');');
assert(SDPobjValue, 3.25, 1e-5)
assert(~isempty(strfind(shown, '# parameters:')))
assert(~isempty(strfind(shown, 'SDPobjValue')))
shown = evalc('[~,SDPobjValue] = sparsePOP(''quartics(2, -1)'');');
assert(SDPobjValue, -2, 1e-5)
assert(~isempty(strfind(shown, 'POP.xVect')))
shown = evalc('sparsePOP(''quartics(2, -1)'', param);');
assert(isempty(shown))
