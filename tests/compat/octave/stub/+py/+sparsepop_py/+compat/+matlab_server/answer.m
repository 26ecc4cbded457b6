function answer(file)
% One interpreter a call; MATLAB keeps its own.
python = getenv('SPARSEPOP_PYTHON');
code = sprintf('from %s import answer; answer(r"%s")', getenv('STUB_MODULE'), file);
assert(system(sprintf('%s -c ''%s''', python, code)), 0)
