* max x1*x2 + 3 where x1 + x2 <= 1: 3.25 at (1/2, 1/2)
Variables x1,x2,objvar;
Equations e1,e2;
e1.. objvar - x1*x2 =E= 3;
e2.. x1 + x2 =L= 1;
x1.lo = 0; x1.up = 1; x2.lo = 0; x2.up = 1;
Solve m using NLP maximizing objvar;
