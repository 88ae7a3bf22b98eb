"""Every small change of the equations of a control law, by rule, and which could have made a table."""
