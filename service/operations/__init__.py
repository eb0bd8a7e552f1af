"""What may be asked for, whoever asks: routes and explorer."""
