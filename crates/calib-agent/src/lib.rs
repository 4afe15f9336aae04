//! TD(0) nexting agents: linear and MLP value functions, replay buffer, returns, scores.
