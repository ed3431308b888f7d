def live(stage):
    return True
