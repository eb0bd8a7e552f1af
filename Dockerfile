# One image for the scheduler, the workers and the front end: dask needs the same code on all of them.
FROM python:3.11-slim AS builder
WORKDIR /build
# What others have written, first and of an empty package: an edit of ours does not install it again.
COPY pyproject.toml constraints.txt README.md LICENSE ./
COPY rattle/_version.py rattle/_version.py
RUN python -m venv /venv && touch rattle/__init__.py
RUN /venv/bin/pip install --no-cache-dir --constraint constraints.txt ".[service,postgres,s3]"
COPY rattle rattle
COPY workers workers
COPY service service
COPY gear_rattle gear_rattle
COPY docs docs
RUN /venv/bin/pip install --no-cache-dir --no-deps --force-reinstall .

FROM python:3.11-slim
RUN useradd --uid 1000 rattle && mkdir /data /cache && chown rattle /data /cache
COPY --from=builder /venv /venv
# Kernels are compiled for the processor that runs them: at the first start, into a volume, not into the image.
ENV PATH=/venv/bin:$PATH PYTHONUNBUFFERED=1 RATTLE_CACHE_DIR=/cache MPLCONFIGDIR=/tmp/matplotlib
USER 1000
VOLUME ["/data", "/cache"]
EXPOSE 8000
HEALTHCHECK --interval=10s --timeout=5s --start-period=60s --retries=6 \
    CMD ["python", "-c", "import urllib.request as r; r.urlopen('http://127.0.0.1:8000/v1/health', timeout=3)"]
CMD ["rattle", "serve", "--host", "0.0.0.0", "--port", "8000", "--data", "/data"]
