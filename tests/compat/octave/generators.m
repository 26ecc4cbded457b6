% Generators by name that build their polynomials with the helper functions of the original.
clear all

% terms are added up, zeros dropped, degree and noTerms set; sorted by degree
p.typeCone = 1; p.sizeCone = 1; p.dimVar = 3; p.degree = 2; p.noTerms = 4;
p.supports = sparse([0 0 2; 1 0 0; 0 1 1; 1 0 0]); p.coef = [1; 2; 3; -2];
q = simplifyPolynomial(p);
assert(full(q.supports), [0 1 1; 0 0 2])
assert(full(q.coef), [3; 1])
assert([q.degree q.noTerms], [2 2])
q = multiplyPolynomials(p, q);      % (x3^2 + 3 x2 x3)^2
assert(full(q.supports), [0 2 2; 0 1 3; 0 0 4])
assert(full(q.coef), [9; 6; 1])
assert([q.degree q.noTerms], [4 3])
p.coef = [0; 2; 0; -2];             % nothing is left: one term with coefficient zero
q = simplifyPolynomial(p);
assert(full([q.supports, q.coef]), [0 0 0 0])
assert([q.degree q.noTerms], [0 1])
for power = 0:3                     % one term, of one variable or none: (2 x2^power)^2
    p.supports = [0 power 0]; p.coef = 2; p.noTerms = 1; p.degree = power;
    q = multiplyPolynomials(p, p);
    assert(full([q.supports, q.coef]), [0 2*power 0 4])
    assert([q.degree q.noTerms], [2*power 1])
    assert(nthargout(2, @monomialSort, p.supports, 1:3, 'grevlex'), 1)
end
p.supports = [0 0 2; 1 0 0; 0 1 1; 1 0 0];

% orders of Cox, Little, O'Shea, Ideals, Varieties, and Algorithms (4th ed.), section 2.2:
% x^2 yz^2 is above xy^3 z in 'grlex'; graded, both orders begin with the lower degree
A = [1 0 0; 0 1 0; 0 0 2; 0 0 0; 1 1 0];
[B, I] = monomialSort(A, 1:3, 'grlex');
assert(I, [4; 2; 1; 3; 5])
assert(B, A(I, :))
assert(nthargout(2, @monomialSort, A, 1:3, 'lex'), [4; 3; 2; 1; 5])
assert(nthargout(2, @monomialSort, A, 1:3), [4; 3; 2; 1; 5])
assert(nthargout(2, @monomialSort, A, 1:3, 'grevlex'), [4; 1; 2; 5; 3])
assert(nthargout(2, @monomialSort, A, [1 2], 'lex'), nthargout(2, @sortrows, A, [1 2]))

% Broyden's tridiagonal function, More, Garbow, Hillstrom 1981 (30): the minimum is 0
param.relaxOrder = 2;
param.printLevel = 0;
[param, SDPobjValue, POP] = sparsePOP('broydenTridiagonal(6)', param);
assert(SDPobjValue <= 0)
assert(SDPobjValue, 0, 1e-4)
assert(POP.objValue, 0, 1e-6)
assert(numel(POP.xVect), 6)
