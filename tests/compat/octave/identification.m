% Intervals of a first-order plant from four samples; by hand they are where half planes meet.
clear all
noise.equation = 0.5;
options.stable = true;
u = [4; -3; 2; 1];
y = [0; -6.25; 1.175; 2.0875];
found = setidIdentify(u, y, 1, 1, 1, 0, noise, options);
assert(found.names, {'a1'; 'b0'})
assert(found.outer, [-0.5232558 -0.3453333; 1.9166667 2.1093023], 2e-7)
assert(all(found.outer(:, 1) <= found.inner(:, 1)) && all(found.inner(:, 2) <= found.outer(:, 2)))
assert(found.status, {'certified'; 'certified'})
assert(logical(found.verified))

% rows serve as columns do, and options may be left out
again = setidIdentify(u', y', 1, 1, 1, 0, noise);
assert(again.outer, found.outer, 1e-12)

% too little noise: no parameters
noise.equation = 0.1;
none = setidIdentify(u, y, 1, 1, 1, 0, noise);
assert(none.status, {'empty'; 'empty'})

% an option that does not exist is an error that names it
options.stabel = true;
try
    setidIdentify(u, y, 1, 1, 1, 0, noise, options);
    error('no error');
catch problem
    assert(~isempty(strfind(problem.message, 'options.stabel')))
end
