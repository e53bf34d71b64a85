"""The paper's figures and figures of merit again, beside ours: one page."""
