* One hyperbola, one half-plane, no bounds on the variables.
* Minimum 52.7066065447 at (8.8605284, 5.3748171).
Variables x1, x2, objvar;
Equations cost, hyperbola, line;
cost..       objvar =E= x1^2 + x2^2 - 4*x1 - 6*x2 + 13;
hyperbola..  x1*x2 - 7*x2 =E= 10;
line..       x2 + 0.5*x1 =G= 1;
Model laboratory / all /;
Solve laboratory using NLP minimizing objvar;
