"""The front end of a survey: REST service, job database, command line and Python client."""
