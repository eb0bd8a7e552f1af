"""Many flights computed at once, one in each lane of a processor's vector registers."""
