* Twelve variables in a chain: sparse, so the blocks stay small.
* Each is coupled with its two neighbours by a product and a distance.
Variables x1, x2, x3, x4, x5, x6, x7, x8, x9, x10, x11, x12, objvar;
Equations cost, e1, e2, e3, e4, e5, e6, e7, e8, e9, e10, e11;
cost..  objvar =E= - x1*x2 + x2*x3 - x3*x4 + x4*x5 - x5*x6 + x6*x7 - x7*x8
                   + x8*x9 - x9*x10 + x10*x11 - x11*x12 + 0.3*x1 + 0.2*x6 - 0.1*x12;
e1..   (x1 - x2)^2 =G= 0.25;
e2..   (x2 - x3)^2 =G= 0.25;
e3..   (x3 - x4)^2 =G= 0.25;
e4..   (x4 - x5)^2 =G= 0.25;
e5..   (x5 - x6)^2 =G= 0.25;
e6..   (x6 - x7)^2 =G= 0.25;
e7..   (x7 - x8)^2 =G= 0.25;
e8..   (x8 - x9)^2 =G= 0.25;
e9..   (x9 - x10)^2 =G= 0.25;
e10..  (x10 - x11)^2 =G= 0.25;
e11..  (x11 - x12)^2 =G= 0.25;
x1.lo = -1;   x1.up = 1;
x2.lo = -1;   x2.up = 1;
x3.lo = -1;   x3.up = 1;
x4.lo = -1;   x4.up = 1;
x5.lo = -1;   x5.up = 1;
x6.lo = -1;   x6.up = 1;
x7.lo = -1;   x7.up = 1;
x8.lo = -1;   x8.up = 1;
x9.lo = -1;   x9.up = 1;
x10.lo = -1;  x10.up = 1;
x11.lo = -1;  x11.up = 1;
x12.lo = -1;  x12.up = 1;
Model chain / all /;
Solve chain using NLP minimizing objvar;
