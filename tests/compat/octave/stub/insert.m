function insert(folders, place, folder)
% Stands for the method of Python's sys.path.
assert(isa(place, 'int32') && place == 0)
setenv('PYTHONPATH', folder)
