"""Global search for the suprema that a certificate estimates."""
