"""Who runs what, on which data: recordings, commands, simulators and reports."""
