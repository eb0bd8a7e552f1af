# One image for the scheduler, the workers and the front end: dask needs the same code on all of them.
FROM python:3.11-slim

RUN useradd --create-home --uid 1000 rattle && mkdir /data && chown rattle /data
WORKDIR /app
COPY pyproject.toml constraints.txt README.md ./
COPY rattle rattle
COPY workers workers
COPY service service
RUN pip install --no-cache-dir --constraint constraints.txt ".[service,postgres]"

USER rattle
VOLUME /data
CMD ["rattle", "serve", "--host", "0.0.0.0", "--port", "8000", "--data", "/data"]
