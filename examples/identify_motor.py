"""A DC motor: from a record of the speed to intervals of its five physical parameters.

The record is simulated: J dw/dt = K i - b w, L di/dt = u - R i - K w, the voltage u switching
between -1 and 1, the speed w measured to 0.01 every 0.05 s.
"""

import numpy as np

import setid

J, b, K, R, L, Ts = 0.02, 0.1, 0.3, 1.0, 0.2, 0.05
generator = np.random.default_rng(3)
u = np.repeat(generator.choice([-1.0, 1.0], 10), 4)
model = setid.ContinuousTransferFunction(2, 0, hold="constant", Ts=Ts)
top, bottom = model.discrete([R / L + b / J, (b * R + K**2) / (J * L), K / (J * L)])
w = np.zeros(u.size)
for k in range(u.size):
    past = [(w[k - i], u[k - i]) if k >= i else (0.0, 0.0) for i in (1, 2)]
    w[k] = top[0] * u[k] + sum(top[i] * past[i - 1][1] - bottom[i] * past[i - 1][0] for i in (1, 2))
data = setid.IOData(u, w + generator.uniform(-0.01, 0.01, u.size), Ts=Ts)

options = setid.Options(time_limit=60)
coefficients = setid.identify(data, model, setid.Noise(output=0.01), setid.Stable(), options)
print(coefficients.table(), "\n")

# Three coefficients do not give five parameters: K and R are measured apart, to some per cent.
physical = setid.Physical(
    {"J": (0.001, 1), "b": (0, 1), "K": (0.28, 0.32), "R": (0.95, 1.05), "L": (0.01, 2)},
    ["a1 = R/L + b/J", "a0 = (b*R + K^2)/(J*L)", "b0 = K/(J*L)"],
)
result = setid.reparametrise(coefficients, physical, options)
print(result.table())
print("verified      ", bool(result.verify(data)))
