"""How hard a motion rattles: its impacts one by one, what they sum up to, their order spectrum, their sound."""
