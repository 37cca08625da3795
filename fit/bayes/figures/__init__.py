"""Pictures of a posterior, a sheet of panels each: its parameters, and what the law says where, beside the rows."""
