"""What a row should have read: chain, effects and nuisances in symbols."""
