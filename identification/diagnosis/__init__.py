"""The diagnosis of the gap between a robot and its model, in the order in which data flow through it.

``columns`` (what may explain a residual), ``noise``, ``blocks`` (Gram matrices), ``fitting``, ``null`` (what chance
gives), ``search`` (which effects), ``rivals`` (what else), ``bounds`` (what would have been seen), ``locate``, ``gap``,
``diagnose`` (all of it), ``result``, and the outputs: ``json_output``, ``report``, ``summary``, ``outputs``.
"""
