"""Many runs of one scenario inside its declared bounds: how close did anything come to a limit?"""
