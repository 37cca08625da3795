"""Excitation signals, the precision they promise, and the files that play them back."""
