"""Executors: processes of our own, an adapter for Ray, and tasks that outlive lost workers."""
