*  Solve m using NLP minimizing objvar;

Variables x1, x2, objvar;

Equations objective, e;

objective.. - objvar + x1*x2 =E= 0;

e.. + 1.0 - x1^2 - x2^2 =G= 0;


Model m / all /;
Solve m using NLP minimizing objvar;
