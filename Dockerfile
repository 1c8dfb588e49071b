# The demo on a CPU: a shipped planner in unseen towns, then a city, a training, both in one table.
#
#   docker build -t shoot .
#   docker run --rm --shm-size 2g -v "$PWD/out:/out" shoot
#
# Any other command: docker run --rm -v "$PWD/out:/out" shoot shoot-plan --example /out/try
FROM python:3.11-slim

# The CPU build first, or pip takes PyPI's, which brings several GB of CUDA.
RUN pip install --no-cache-dir torch torchvision --index-url https://download.pytorch.org/whl/cpu

WORKDIR /src
COPY pyproject.toml README.md LICENSE ./
COPY lss_core lss_core
COPY shoot shoot
COPY templates templates
RUN pip install --no-cache-dir '.[demo,export,video]'

# What a container writes belongs to whom /out belongs to, if `--user "$(id -u):$(id -g)"` is given.
ENV HOME=/tmp MPLCONFIGDIR=/tmp/matplotlib
WORKDIR /out
VOLUME /out
CMD ["shoot-demo", "--out", "/out/demo"]
