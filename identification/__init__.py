"""identification: from recordings to parameters and to the diagnosis of the gap between robot and model."""
