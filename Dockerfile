# docker build -t sparsepop . && docker run --rm sparsepop
# The example problems of `make demo`; pictures: docker run --rm -v "$PWD/demo_output:/app/demo_output" sparsepop
FROM python:3.12-slim

# hadolint ignore=DL3008
RUN apt-get update \
 && apt-get install --yes --no-install-recommends make \
 && rm -rf /var/lib/apt/lists/*

WORKDIR /app
COPY pyproject.toml Makefile README.md LICENSE MANIFEST.in ./
COPY sparsepop_py sparsepop_py
COPY setid setid
COPY matlab matlab
COPY examples examples

ENV OMP_NUM_THREADS=1
RUN make .venv/.with-plot PYTHON=python3

CMD ["make", "demo"]
