* Eight sites in a ring: which of them to open? Opening pays, open neighbours
* disturb each other, and at most four may be open.
Variables b1, b2, b3, b4, b5, b6, b7, b8, objvar;
Binary Variables b1, b2, b3, b4, b5, b6, b7, b8;
Equations cost, most;
cost..  objvar =E= - 5*b1 - 3*b2 - 6*b3 - 4*b4 - 5*b5 - 2*b6 - 7*b7 - 4*b8
                   + 4*b1*b2 + 3*b2*b3 + 5*b3*b4 + 2*b4*b5
                   + 6*b5*b6 + 4*b6*b7 + 5*b7*b8 + 3*b8*b1;
most..  b1 + b2 + b3 + b4 + b5 + b6 + b7 + b8 =L= 4;
Model binary / all /;
Solve binary using MINLP minimizing objvar;
