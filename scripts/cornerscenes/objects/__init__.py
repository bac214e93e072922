from .dog import sitting_dog, standing_dog
BUILDERS = {"sitting_dog": sitting_dog, "standing_dog": standing_dog}
