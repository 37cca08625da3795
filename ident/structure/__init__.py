"""Choice of the model structure: candidates, continuous forms, criterion."""
