"""What Python can ask: questions about methods, stored rows as frames, assertions for tests, a summary of a run."""
