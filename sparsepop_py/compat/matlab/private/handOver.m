function answer = handOver(task, given)
% Have Python call the function named task; warn and fail as it says.
%
%   The question is written to a file, over which Python writes the answer: a struct with the
%   field outputs, a cell array.

question.task = task;
question.arguments = cellfun(@asChar, given, 'UniformOutput', false);
question.folder = pwd;  % names of files in param are relative to it
file = [tempname(), '.mat'];
tidy = onCleanup(@() removed(file));
save(file, '-struct', 'question', '-v6');
askPython('ask', file);
answer = load(file);
for k = 1:numel(answer.warnings)
    warning('sparsePOP:param', '%s', answer.warnings{k});
end
if ~isempty(answer.error)
    error('sparsePOP:input', '%s', answer.error);
end
end

function value = asChar(value)
% Strings of MATLAB's class string, also as fields of a struct, as char arrays.
if isstruct(value) && isscalar(value)
    value = structfun(@asChar, value, 'UniformOutput', false);
elseif isa(value, 'string')
    value = char(value);
end
end

function removed(file)
if exist(file, 'file')
    delete(file);
end
end
