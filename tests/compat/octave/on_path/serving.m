function pid = serving()
% The child of this Octave process that answers, [] without one. pgrep sees whole command lines,
% which ps may cut to the width of a terminal.
[~, found] = system(sprintf('pgrep -P %d -f "[m]atlab_server.serve"', getpid()));
pid = sscanf(found, '%d');
