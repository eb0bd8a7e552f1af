"""The parameters of the paper's figures: (δ, ε), where each is one number, several numbers or a range (low, high)."""

BETA = 0.6

FIGURE_4 = 0.6, (0.056, 0.0615, 0.067, 0.0725, 0.078, 0.0835, 0.089, 0.0945, 0.1)
FIGURE_5 = 0.6, (0.05, 0.15)
FIGURE_6 = 0.6, 0.1
FIGURE_7 = (0.4, 1.0), (0.0, 0.3)
FIGURE_8 = (0.74, 0.78), (0.092, 0.1)
#: The paper's ε axis has no numbers; this range is from below SN1 to beyond the end of the chaotic attractor.
FIGURE_9 = 0.762, (0.0957, 0.0977)
