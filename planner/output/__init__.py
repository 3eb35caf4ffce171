"""What a plan is written as: tables, programs, figures, traces, certificates."""
