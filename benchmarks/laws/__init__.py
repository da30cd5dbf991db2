"""Cases with known answers for laws that real robots have and the catalogue of effects does not."""
