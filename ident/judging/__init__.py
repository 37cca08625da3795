"""What a model is worth: free runs, residuals, bands, the response as measured, closed loops found out."""
