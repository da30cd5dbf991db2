"""Strict reading of files: ordinary files only, strict YAML, and checked settings."""
