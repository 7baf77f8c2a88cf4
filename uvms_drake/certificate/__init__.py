"""The certificate: constants, tube, sets and terminal ingredients, computed and checked."""
