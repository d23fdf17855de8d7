"""The operator's page: what is shown (state), who may ask (security), what is served (web)."""
