function askPython(task, file)
% Has Python answer the question in a MAT file, over which the answer is written.
%
%   askPython('ask', file) blocks until that is done and shows what Python prints. The
%   interpreter is started by the first call and kept: it lives in MATLAB (py.), or it is a
%   child process that reads the names of files, one a line, and ends when its input closes.
%   askPython('settle') ends an interpreter whose answer was not waited for (Ctrl-C, an error).

persistent child working
mlock  % "clear all" at the head of scripts would forget the child
if strcmp(task, 'settle')
    if working
        stop(child);
        child = [];
    end
    working = false;
    return
end
if ~isempty(working) && working
    error('sparsePOP:busy', 'sparsePOP was called while another call is waiting for its answer.');
end
python = chosenPython();
if ~isReady(child, python)
    stop(child);
    child = [];
    child = start(python);
end
working = true;
guard = onCleanup(@() askPython('settle'));
exchange(child, file);
child.served = true;
working = false;
end

% ---- which Python, and which way to it ----------------------------------------------------

function python = chosenPython()
% SPARSEPOP_PYTHON, else the environment that holds this file, else python3.
python = getenv('SPARSEPOP_PYTHON');
if isempty(python)
    root = packageRoot();
    near = {fullfile(root, '.venv', 'bin', 'python'), ...
            fullfile(root, '.venv', 'Scripts', 'python.exe')};
    [above, name] = fileparts(root);
    if any(strcmp(name, {'site-packages', 'dist-packages'}))
        near = {fullfile(fileparts(fileparts(above)), 'bin', 'python3'), ...
                fullfile(fileparts(above), 'Scripts', 'python.exe')};
    end
    exists = cellfun(@(file) exist(file, 'file') == 2, near);
    near = [near(exists), {'python3'}];
    python = near{1};
end
end

function root = packageRoot()
% The folder that holds the package: sparsepop_py/compat/matlab_server.py is there.
root = fileparts(fileparts(mfilename('fullpath')));
while ~exist(fullfile(root, 'sparsepop_py', 'compat', 'matlab_server.py'), 'file')
    above = fileparts(root);
    if strcmp(above, root)
        error('sparsePOP:python', ['sparsepop_py/compat/matlab_server.py was not found above %s. Add the ' ...
              'folder of the installed package to the path instead of copying its files: ' ...
              'python -m sparsepop_py.compat.matlab_server folder'], mfilename('fullpath'));
    end
    root = above;
end
end

function way = chosenWay()
% 'py' is Python inside MATLAB, 'pipe' a child of Octave, 'java' a child by Java.
way = getenv('SPARSEPOP_DOOR');
if isempty(way)
    if exist('pyenv') %#ok<EXIST> a function, in whatever form
        way = 'py or java';
    elseif exist('popen2') %#ok<EXIST>
        way = 'pipe';
    else
        way = 'java';
    end
elseif ~any(strcmp(way, {'py', 'pipe', 'java'}))
    error('sparsePOP:python', 'SPARSEPOP_DOOR: found ''%s'', expected py, pipe or java', way);
end
end

% ---- start, check, stop -------------------------------------------------------------------

function child = start(python)
child = struct('way', chosenWay(), 'asked', getenv('SPARSEPOP_DOOR'), 'python', python, ...
               'served', false);
serve = {'-X', 'utf8', '-c', ['import os, sys; os.dup2(1, 2); sys.path[0] = sys.argv[1]; ' ...
                'from sparsepop_py.compat import matlab_server; matlab_server.serve()'], packageRoot()};
switch child.way
    case 'py'
        insidePython(python);
    case 'py or java'
        try
            insidePython(python);
            child.way = 'py';
        catch
            child.way = 'java';
            child = startJava(child, [{python}, serve]);
        end
    case 'java'
        child = startJava(child, [{python}, serve]);
    case 'pipe'
        [child.in, child.out, child.pid] = popen2(python, serve);
        child.pipes = [child.in, child.out];
        child.names = {fopen(child.in), fopen(child.out)};
end
end

function insidePython(python)
% Python in MATLAB, in a process of its own unless other code has loaded Python before.
environment = pyenv();
if ~strcmp(char(environment.Status), 'NotLoaded')
    if ~any(strcmp(python, {'python3', char(environment.Executable)}))
        error('sparsePOP:python', 'MATLAB has loaded %s already, which is not %s', ...
              char(environment.Executable), python);
    end
elseif strcmp(python, 'python3')
    pyenv('ExecutionMode', 'OutOfProcess');
else
    pyenv('Version', python, 'ExecutionMode', 'OutOfProcess');
end
folders = py.sys.path;
insert(folders, int32(0), packageRoot());
py.importlib.import_module('sparsepop_py.compat.matlab_server');
end

function child = startJava(child, words)
list = javaObject('java.util.ArrayList');
for k = 1:numel(words)
    list.add(words{k});
end
builder = javaObject('java.lang.ProcessBuilder', list);
builder.redirectErrorStream(true);
child.process = builder.start();
child.in = javaObject('java.io.PrintStream', child.process.getOutputStream(), true, 'UTF-8');
child.out = javaObject('java.io.BufferedReader', ...
    javaObject('java.io.InputStreamReader', child.process.getInputStream(), 'UTF-8'));
end

function ready = isReady(child, python)
% Whether it lives, and the same interpreter is still asked for in the same way.
ready = ~isempty(child) && strcmp(child.python, python) ...
    && strcmp(child.asked, getenv('SPARSEPOP_DOOR')) && isAlive(child);
end

function alive = isAlive(child)
switch child.way
    case 'py'
        alive = true;
    case 'java'
        alive = child.process.isAlive();
    case 'pipe'
        alive = all(areOpen(child)) && waitpid(child.pid, WNOHANG()) == 0;
end
end

function stop(child)
if isempty(child)
    return
end
switch child.way
    case 'java'
        child.process.destroy();
    case 'pipe'
        if waitpid(child.pid, WNOHANG()) == 0
            kill(child.pid, 9);
            waitpid(child.pid);
        end
        arrayfun(@fclose, child.pipes(areOpen(child)));
end
end

function open = areOpen(child)
% "fclose all" in scripts closes pipes, and their numbers may be those of other files then.
open = arrayfun(@(pipe, name) is_valid_file_id(pipe) && strcmp(fopen(pipe), name{1}), ...
                child.pipes, child.names);
end

% ---- question and answer ------------------------------------------------------------------

function exchange(child, file)
% Send the name of the file; show what comes back until the line that ends an answer.
switch child.way
    case 'py'
        py.sparsepop_py.compat.matlab_server.answer(file);
        return
    case 'java'
        child.in.println(file);
    case 'pipe'
        fprintf(child.in, '%s\n', file);
        fflush(child.in);
end
theEnd = char(4);
wait = 0.001;
while true
    alive = isAlive(child);  % asked first, so that last words are still read
    line = nextLine(child);
    if ischar(line)
        fprintf('%s', line(1:find([line, theEnd] == theEnd, 1) - 1));
        if any(line == theEnd)
            return
        end
        wait = 0.001;
    elseif ~alive
        endedEarly(child);
    else
        pause(wait);
        wait = min(1.1 * wait, 0.05);
    end
end
end

function endedEarly(child)
if child.served
    error('sparsePOP:python', ['Python ended without an answer; it may have run out of ' ...
          'memory. The next call starts it again.']);
end
error('sparsePOP:python', ['%s ended without an answer. It has to be Python 3.11 or newer ' ...
      'with the package sparsepop_py; the environment variable SPARSEPOP_PYTHON names ' ...
      'another one.'], child.python);
end

function line = nextLine(child)
% What is there to read, at most one line; -1 for nothing.
line = -1;
if strcmp(child.way, 'pipe')
    line = fgets(child.out);
    if ~ischar(line)
        fclear(child.out);  % nothing yet looks like the end of a file
    end
elseif child.out.ready()
    line = [char(child.out.readLine()), char(10)]; %#ok<CHARTEN> older versions
end
end
