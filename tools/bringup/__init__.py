"""What the bring-up and calibration commands share."""
