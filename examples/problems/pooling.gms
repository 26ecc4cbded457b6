* Two crudes share a tank of unknown quality q, a third is bought as it is.
* All three are blended into two fuels with limits on quality and on demand.
* in1, in2:    crude of quality 4 and 1 into the tank, at cost 5 and 10
* out1, out2:  from the tank to fuel 1 (at most quality 3) and fuel 2 (at most 1.6)
* add1, add2:  crude of quality 2 added to fuel 1 and to fuel 2, at cost 10
* The fuels sell at 11 and 16; demands are 60 and 90. The profit is maximised.
Variables in1, in2, q, out1, out2, add1, add2, objvar;
Positive Variables in1, in2, out1, out2, add1, add2;
Equations profit, volume, quality, fuel1, fuel2, demand1, demand2;
profit..   objvar =E= 11*(out1 + add1) + 16*(out2 + add2)
                      - 5*in1 - 10*in2 - 10*(add1 + add2);
volume..   in1 + in2 =E= out1 + out2;
quality..  4*in1 + in2 =E= q*(out1 + out2);
fuel1..    q*out1 + 2*add1 =L= 3*(out1 + add1);
fuel2..    q*out2 + 2*add2 =L= 1.6*(out2 + add2);
demand1..  out1 + add1 =L= 60;
demand2..  out2 + add2 =L= 90;
q.lo = 1;
q.up = 4;
in1.up = 150;
in2.up = 80;
Model pooling / all /;
Solve pooling using NLP maximizing objvar;
