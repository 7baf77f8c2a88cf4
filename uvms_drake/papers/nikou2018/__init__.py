"""The scheme of Nikou, Verginis and Dimarogonas (2018), its simulation and its errata."""
