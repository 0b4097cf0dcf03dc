# flowsculpt in a container: docker build -t flowsculpt . && docker run --rm -v "$PWD":/show flowsculpt film
# Debian 12 has Python 3.11; set-up unpacks libLLVM from its packages. A GPU, where the host passes one on, is found.
FROM debian:bookworm-slim

RUN apt-get update && apt-get install -y --no-install-recommends ca-certificates make python3 python3-venv

# Packages, renderer and kernels are made at build time. Any user of the container may write the cache of kernels,
# for one that cannot be written is not used.
ENV XDG_CACHE_HOME=/opt/flowsculpt/.cache
ENV PIP_NO_CACHE_DIR=1
COPY . /opt/flowsculpt
RUN make -C /opt/flowsculpt setup && chmod -R a+rX /opt/flowsculpt && chmod -R a+rwX $XDG_CACHE_HOME \
    && rm -rf /var/lib/apt/lists

ENV PATH=/opt/flowsculpt/.venv/bin:$PATH
WORKDIR /show
ENTRYPOINT ["flowsculpt"]
CMD ["--help"]
