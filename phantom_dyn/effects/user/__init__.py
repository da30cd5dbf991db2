"""Effects that a user defines: reading them, and trying them on a robot before they are used."""
