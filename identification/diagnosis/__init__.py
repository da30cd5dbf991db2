"""The diagnosis of the gap between a robot and its model, in the order in which data flow through it.

``operations``, ``columns`` (what may explain a residual) and ``rest``, ``noise`` and ``whitening``, ``blocks`` (Gram
matrices), ``problem``, ``products``, ``fitting``, ``bounded`` and ``point_mass``, ``null`` (what chance gives),
``search`` (rivals and claims), ``swaps``, ``nameless`` and ``stepwise`` (which effects), ``judge`` and ``gap`` (what
they close), ``rivals`` (what else), ``bounds`` (what would have been seen), ``locate``, ``parameters``, ``findings``,
``verdict``, ``evidence``, ``assemble``, ``diagnose`` (all of it), ``result``, and the outputs: ``json_output``,
``report``, ``summary``, ``outputs``.
"""
