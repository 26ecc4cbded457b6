* A leader chooses x; a follower answers with y, which minimises (y - x)^2 + 2*y
* subject to y >= 0 and y <= 3. The follower's optimality conditions, with
* multipliers u and v, are equations and complementarity products.
Variables x, y, u, v, objvar;
Positive Variables u, v;
Equations leader, stationary, low, high;
leader..      objvar =E= (x - 2)^2 + (y - 4)^2 - x*y;
stationary..  2*(y - x) + 2 - u + v =E= 0;
low..         u*y =E= 0;
high..        v*(3 - y) =E= 0;
x.lo = 0;
x.up = 5;
y.lo = 0;
y.up = 3;
u.up = 20;
v.up = 20;
Model complementarity / all /;
Solve complementarity using NLP minimizing objvar;
