"""Plans from goals: chains of TOPs, from the TOPs' conditions; numbers are left to refinement."""
