# flowsculpt in a container: docker build -t flowsculpt .
#     docker run --rm --user "$(id -u):$(id -g)" -v "$PWD":/show flowsculpt film
# The show is mounted at /show. Any user may run it; without --user it is user 1000, never root.
# Debian 12 has Python 3.11; set-up unpacks libLLVM from its packages. A GPU, where the host passes one on, is found.
FROM debian:bookworm-slim

RUN apt-get update && apt-get install -y --no-install-recommends ca-certificates make python3 python3-venv \
    && useradd --uid 1000 --create-home flowsculpt && install --directory --owner=flowsculpt /show

# Packages, all of them compiled, renderer and kernels are made at build time, by root. All users read the compiled kernels
# and none may change them, for what lies there runs as code; what is compiled later goes to a folder of the user's in /tmp.
# They are for x86-64-v3 (docs/farm.md), so that nodes with other processors than the machine that builds the image compile
# none.
ENV XDG_CACHE_HOME=/opt/flowsculpt/.cache
ENV PIP_NO_CACHE_DIR=1
COPY . /opt/flowsculpt
RUN make -C /opt/flowsculpt setup \
    && /opt/flowsculpt/.venv/bin/python -m compileall -q -x '/tests?/' /opt/flowsculpt/.venv/lib \
    && chmod -R a+rX /opt/flowsculpt && mkdir -p -m 1777 $XDG_CACHE_HOME/snakemake && rm -rf /var/lib/apt/lists

ENV PATH=/opt/flowsculpt/.venv/bin:$PATH
USER 1000:1000
WORKDIR /show
ENTRYPOINT ["flowsculpt"]
CMD ["--help"]
