//! Start states, rollouts and replay: streams of states for an agent.
