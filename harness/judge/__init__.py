"""Judge: measure motions, hold them against laws and true motions, certify orders, keep the gate, count claims."""
