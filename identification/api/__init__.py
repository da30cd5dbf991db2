"""The Python interface behind ``import phantom_dyn as dyn``: each command as a function of file paths or objects."""
