"""Draw the variables of a survey as maps over the (δ, ε) plane, with matplotlib."""
