% What goes wrong is an error or a warning here, and the next call works.
clear all
function problem = caught(varargin)
    problem = struct('message', 'none', 'identifier', '');
    try
        sparsePOP(varargin{:});
    catch problem
    end
end
said = @(text, varargin) assert(~isempty(strfind(caught(varargin{:}).message, text)), ...
                                '%s', caught(varargin{:}).message);
[objPoly, ineqPolySys, lbd, ubd] = quartics(2, -1);
param.printLevel = 0;
param.relaxOrder = 2;

said('Input has something wrong.')
said('Input has something wrong.', objPoly)
said('Input has something wrong.', objPoly, ineqPolySys)
said('Input has something wrong.', objPoly, ineqPolySys, lbd)
said('Input has something wrong.', objPoly, ineqPolySys, lbd, ubd, param, 1)
said('## Input file does not exist.', 'nowhere.gms')
said('## Input file does not exist.', 'nowhere.gms', param)
said('nosuchfunction', 'nosuchfunction(3)', param)

% fields are named as they are written here, counted from 1
wrong = ineqPolySys; wrong{2} = wrong{1}; wrong{2}.degree = 3;
said('ineqPolySys{2}.degree: found 3, expected 1', objPoly, wrong, lbd, ubd, param)
said('objPoly{1}.noTerms: found 7', {setfield(objPoly, 'noTerms', 7), objPoly}, [], lbd, ubd)
said('lbd', objPoly, ineqPolySys, [0 3], [1 2], param)
said('lbd', objPoly, ineqPolySys, [0 0 0], ubd, param)
said('param.boundSW', objPoly, ineqPolySys, lbd, ubd, struct('boundSW', 7))
assert(caught(objPoly, wrong, lbd, ubd, param).identifier, 'sparsePOP:input')

% a warning names the nearest field; it can be switched off like any other
lastwarn('')
state = warning('off', 'sparsePOP:param');
sparsePOP(objPoly, ineqPolySys, lbd, ubd, setfield(param, 'relaxorder', 2));
warning(state)
warning('on', 'sparsePOP:param')
text = evalc('sparsePOP(objPoly, ineqPolySys, lbd, ubd, setfield(param, ''sparsesw'', 0));');
[message, identifier] = lastwarn();
assert(identifier, 'sparsePOP:param')
assert(~isempty(strfind(message, 'sparseSW')))

[~, SDPobjValue] = sparsePOP(objPoly, ineqPolySys, lbd, ubd, param);
assert(SDPobjValue, -2, 1e-5)
