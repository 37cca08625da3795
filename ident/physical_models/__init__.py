"""Physical models fitted to records: feed drive, cutting force process, step responses."""
