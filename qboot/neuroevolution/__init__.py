"""Neuro-evolution: DNN networks under NSGA-II with behavioural diversity (paper, section III-B)."""
