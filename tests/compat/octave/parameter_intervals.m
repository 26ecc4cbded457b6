% Parameter uncertainty intervals, one parameter after the other, lower end then upper end.
% y1 - e1 = p1 (u1 - d1) and y2 - e2 = p1 + p2 with u1 = 2, y1 = 3, y2 = 5 and all errors
% within 0.1, so that p1 is in [2.9/2.1, 3.1/1.9] and p2 in [4.9 - 3.1/1.9, 5.1 - 2.9/2.1].
clear all
close all

p = 2;  n = 5;                      % variables p1 p2 d1 e1 e2
u1 = 2; y1 = 3; y2 = 5; Deltau = 0.1; Deltay = 0.1;

ineqPolySys{1}.typeCone = -1;
ineqPolySys{1}.sizeCone = 1;
ineqPolySys{1}.dimVar = n;
ineqPolySys{1}.degree = 2;
ineqPolySys{1}.noTerms = 4;
ineqPolySys{1}.supports = [0 0 0 0 0; 0 0 0 1 0; 1 0 0 0 0; 1 0 1 0 0];
ineqPolySys{1}.coef = [y1; -1; -u1; 1];

ineqPolySys{2}.typeCone = -1;
ineqPolySys{2}.sizeCone = 1;
ineqPolySys{2}.dimVar = n;
ineqPolySys{2}.degree = 1;
ineqPolySys{2}.noTerms = 4;
ineqPolySys{2}.supports = [0 0 0 0 0; 0 0 0 0 1; 1 0 0 0 0; 0 1 0 0 0];
ineqPolySys{2}.coef = [y2; -1; -1; -1];

lbd = [-10 -10 -Deltau -Deltay -Deltay];
ubd = [ 10  10  Deltau  Deltay  Deltay];

param.relaxOrder = 2;
param.POPsolver = 'active-set';
param.printLevel = [0 0];

for i = 1:2*p
    k = ceil(i/2);
    objPoly.typeCone = 1;
    objPoly.sizeCone = 1;
    objPoly.dimVar = n;
    objPoly.degree = 1;
    objPoly.noTerms = 1;
    objPoly.supports = zeros(1,n);
    objPoly.supports(k) = 1;
    objPoly.coef = (-1)^(i+1);
    [param,SDPobjValue,POP,elapsedTime,SDPsolverInfo,SDPinfo] = ...
        sparsePOP(objPoly,ineqPolySys,lbd,ubd,param);
    if mod(i,2) == 1
        pmin(k) = POP.xVectL(k);
        below(k) = SDPobjValue;
    else
        pmax(k) = POP.xVectL(k);
        above(k) = -SDPobjValue;
    end
    value(i) = POP.objValue;
    seconds(i) = elapsedTime.total;
end

least    = [2.9/2.1, 4.9 - 3.1/1.9];
greatest = [3.1/1.9, 5.1 - 2.9/2.1];
assert(pmin, least, 1e-5)
assert(pmax, greatest, 1e-5)
assert(below, least, 1e-5)
assert(above, greatest, 1e-5)
assert(all(below <= least + eps(4)) && all(above >= greatest - eps(4)))
assert(value, [least(1) -greatest(1) least(2) -greatest(2)], 1e-5)
assert(all(seconds > 0))
