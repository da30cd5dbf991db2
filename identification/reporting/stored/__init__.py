"""Files of a diagnosis: written together, described by a schema, and read again."""
