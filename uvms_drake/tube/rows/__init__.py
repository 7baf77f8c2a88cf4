"""The tube of the law `tip first`: disturbance gains, remainder terms, image in all channels."""
