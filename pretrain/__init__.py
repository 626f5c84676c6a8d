"""Stage two of LanGWM: the language-grounded masked autoencoder."""
