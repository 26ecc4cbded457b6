function result = setidIdentify(u, y, Ts, na, nb, nk, noise, options)
%SETIDIDENTIFY  Proved parameter intervals of a transfer function from a record with bounded noise.
%
%   result = setidIdentify(u, y, Ts, na, nb, nk, noise, options)
%
%   y(k) = -a1 y(k-1) - ... - a_na y(k-na) + b_nk u(k-nk) + ... , samples in rows, channels in
%   columns. noise is the bound of the output noise, or a struct with fields output, input and
%   equation. options is a struct with any of the fields stable, dcGain = [low high], offset,
%   initial ('free' or 'zero'), commonDenominator, timeLimit (seconds), tol, inputNames,
%   outputNames; it may be left out.
%
%   result is a struct. result.names is a cell array of the parameters, a row of result.outer
%   their proved interval (no consistent parameter lies outside), a row of result.inner values
%   that consistent parameters attain (NaN where none was found), result.status says what is
%   known. result.best is a member that simulates well, result.verified is true where every
%   claim was checked again without a solver. disp(result.table) prints the table.
%   eval(result.ureal) makes the uncertain model G of the Robust Control Toolbox, and
%   save('model.mat', '-struct', 'result') keeps all of it.

if nargin < 7 || nargin > 8
    error('sparsePOP:input', ['Input has something wrong: expected ' ...
          'setidIdentify(u, y, Ts, na, nb, nk, noise, options).']);
end
if nargin < 8
    options = struct();
end
answer = handOver('setid.matlab:identify_structs', {u, y, Ts, na, nb, nk, noise, options});
result = answer.outputs{1};
end
