% With functions that stand for MATLAB's own: Python is asked through py. where there is pyenv.
clear all
addpath(fullfile(pwd, 'stub'))
[~, SDPobjValue, POP] = sparsePOP('quartics(1, -1)', struct('printLevel', 0, 'relaxOrder', 2));
assert(SDPobjValue, -1, 1e-5)
environment = pyenv();
assert(environment.told, ...
       {'Version', getenv('SPARSEPOP_PYTHON'), 'ExecutionMode', 'OutOfProcess'})
