"""What `rattle bench` measures, peers included: no product code imports it but the command."""
