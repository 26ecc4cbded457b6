function [param, SDPobjValue, POP, cpuTime, SDPsolverInfo, SDPinfo] = sparsePOP(varargin)
%SPARSEPOP  Proved bounds of a polynomial optimization problem, called like SparsePOP 3.03.
%
%   sparsePOP('file.gms')                       a GAMS scalar file, found on the path
%   sparsePOP('name(arguments)')                [objPoly,ineqPolySys,lbd,ubd] = name(arguments)
%   sparsePOP(objPoly, ineqPolySys, lbd, ubd)   structs; a cell array objPoly: least squares
%
%   each with a struct param as one more argument, return
%
%   [param, SDPobjValue, POP, cpuTime, SDPsolverInfo, SDPinfo]
%
%   SDPobjValue is a proved lower bound of the minimum (for a file that maximises, an upper
%   bound of the maximum), -Inf if nothing is proved, +Inf if no point is feasible. The value
%   of the relaxation, which is no bound, is POP.solverValue; POP.status says what is known.
%
%   The work is done by the Python package sparsepop_py, in the interpreter named by the
%   environment variable SPARSEPOP_PYTHON, else in the environment that holds this file, else
%   by python3. Installation, outputs and limits: docs/matlab.md of the package.

switch nargin
    case {1, 2}
        problem = namedProblem(varargin{1});
        given = varargin(2:end);
    case {4, 5}
        problem = varargin(1:4);
        given = varargin(5:end);
    otherwise
        wrongInput();
end
answer = handOver('sparsePOP', [reshape(problem, 1, []), given]);
[param, SDPobjValue, POP, cpuTime, SDPsolverInfo, SDPinfo] = answer.outputs{:};
end

% ---- what is asked ------------------------------------------------------------------------

function problem = namedProblem(name)
% One file name, or the four structs that a call written as a string returns.
if isa(name, 'string')
    name = char(name);
end
if ~ischar(name)
    wrongInput();
elseif isempty(strfind(name, '.gms')) %#ok<STREMP> older versions have no contains
    problem = evaluated(name);
else
    problem = {found(name)};
end
end

function ans__ = evaluated(call__)
% A scope of its own, as in the original: the caller's variables are not seen.
ans__ = cell(1, 4);
[ans__{:}] = eval(call__);
end

function file = found(name)
if exist(name, 'file') ~= 2
    error('sparsePOP:input', '## Input file does not exist.');
end
if exist('OCTAVE_VERSION', 'builtin')
    file = file_in_loadpath(name);
else
    file = which(name);
end
if isempty(file)
    file = name;
end
end

function wrongInput()
error('sparsePOP:input', 'Input has something wrong.');
end
