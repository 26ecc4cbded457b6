* A nonconvex quartic with several local minima, on a box cut by a parabola.
Variables x, y, objvar;
Equations cost, parabola;
cost..      objvar =E= x^4 - 3*x^2 + 0.5*x + y^4 - 2*y^2 - 0.3*y + x*y;
parabola..  y - 0.5*x^2 =G= -1.2;
x.lo = -2;
x.up = 2;
y.lo = -2;
y.up = 2;
Model quartic / all /;
Solve quartic using NLP minimizing objvar;
