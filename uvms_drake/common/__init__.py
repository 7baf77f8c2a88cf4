"""What every room uses: errors, reading YAML, writing files, alarms."""
