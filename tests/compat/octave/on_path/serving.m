function pid = serving()
% The child of this Octave process that answers, [] without one. pgrep sees whole command lines,
% which ps may cut to the width of a terminal.
[~, found] = system(sprintf('pgrep -P %d -f "[d]oor.serve"', getpid()));
pid = sscanf(found, '%d');
