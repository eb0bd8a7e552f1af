"""The front end for surveys and populations: REST service, job database, command line and Python client."""
