"""What a laboratory has on disk, turned into a recording folder.

Every reader hands back tables of named columns with a clock each (:mod:`.tables`); a map says which
column means what and in which unit (:mod:`.mapping`); tables meet at the nearest moment
(:mod:`.joining`); what can be derived from the path is derived on request (:mod:`.joining`);
:mod:`.understood` holds the rows as they will be written, for a reader to look at first.
"""
