function environment = pyenv(varargin)
% Stands for MATLAB's function: remembers what it was told.
persistent told
told = [told, varargin];
environment = struct('Status', 'NotLoaded', 'Executable', '', 'told', {told});
