function [objPoly, ineqPolySys, lbd, ubd] = quartics(n, s)
% sum of x_i^4 - 2 x_i^2 over |x_i| <= 2 and x_1 >= s: each term is least, -1, at x_i = 1
objPoly.typeCone = 1;
objPoly.sizeCone = 1;
objPoly.dimVar = n;
objPoly.degree = 4;
objPoly.noTerms = 2*n;
objPoly.supports = [4*speye(n); 2*speye(n)];
objPoly.coef = [ones(n,1); -2*ones(n,1)];
ineqPolySys{1}.typeCone = 1;
ineqPolySys{1}.sizeCone = 1;
ineqPolySys{1}.dimVar = n;
ineqPolySys{1}.degree = 1;
ineqPolySys{1}.noTerms = 2;
ineqPolySys{1}.supports = sparse(1,1,1,2,n);
ineqPolySys{1}.coef = [1; -s];
lbd = -2*ones(1,n);
ubd =  2*ones(1,n);
