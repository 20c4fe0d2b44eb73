"""The paper's search: free parameters at each gap, then the reduction."""
