"""A measured record: intervals of a hair dryer and its prediction on the rest of the record."""

from pathlib import Path

from style import save

import setid

path = Path(__file__).resolve().parents[1] / "data" / "hairdryer.csv"
data = setid.IOData.from_csv(path, inputs="u", outputs="y", Ts=0.08)
record, rest = data.split(200)
model = setid.TransferFunction(na=2, nb=2, nk=3, offset=True)
result = setid.identify(record, model, setid.Noise(equation=0.11), [setid.Stable()])
print(result.table())

save("hairdryer_intervals", lambda: result.plot().get_figure(root=True))
save("hairdryer_bode", lambda: result.bode().plot()[0].get_figure(root=True))
save(
    "hairdryer_prediction",
    lambda: result.compare(rest, "prediction").plot()[0].get_figure(root=True),
)
