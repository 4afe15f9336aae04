"""Train an encoder on the states of a model and export it: python import_representation.py MODEL_FOLDER."""

import json, sys
import numpy as np, torch

model = sys.argv[1]                                               # the model/ folder of a Euclidean build-model
states = torch.from_numpy(np.load(f"{model}/states.npy"))         # f32 [n, d], normalised
n, d = states.shape
encoder = torch.nn.Sequential(torch.nn.Linear(d, 64), torch.nn.ReLU(), torch.nn.Linear(64, 16))
decoder = torch.nn.Linear(16, d)
adam = torch.optim.Adam([*encoder.parameters(), *decoder.parameters()], lr=1e-3)
for step in range(2000):                                          # an autoencoder; anything will do
    batch = states[torch.randint(n, (256,))]
    loss = (decoder(encoder(batch)) - batch).square().mean()
    adam.zero_grad(), loss.backward(), adam.step()
np.save("psi.npy", encoder(states).detach().numpy())              # one row for each row of model/rows.parquet
json.dump({"data": json.load(open(f"{model}/manifest.json"))["data"]}, open("psi.npy.json", "w"))
